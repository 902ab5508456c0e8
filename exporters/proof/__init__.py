"""The proof run after loading: a diagonal and a line, whose readings show whether each table acts
as exported.
"""
