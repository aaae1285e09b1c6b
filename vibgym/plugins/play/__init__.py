"""Play page: interactive environments in a browser (extra ``play``).

``python -m vibgym play [ID]`` serves it. Data flow: the visitor's session (:mod:`.session`) applies a message of the page to
the world (:mod:`.world`), and returns scene and frames (:mod:`.picture`).
"""
