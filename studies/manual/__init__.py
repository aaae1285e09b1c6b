"""Generated parts of the documentation: tables of results, pages of environments, films, the thesis's figures."""
