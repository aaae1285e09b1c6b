"""The documentation's generated pieces: tables of results, pages of environments, films, the thesis's figures."""
