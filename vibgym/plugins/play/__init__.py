"""Play page: interactive environments in a browser (extra ``play``).

``python -m vibgym play [ID]`` serves it. One way through: a message of the page (:mod:`.messages`) is done by the visitor's
session (:mod:`.session`) to the world (:mod:`.world`), and what comes of it goes back as scene and frames (:mod:`.picture`).
"""
