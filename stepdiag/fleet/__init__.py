"""Many machines over years: an archive of finished surveys, what changed since when, and the old
logs solved anew.

In: folders of finished surveys. Out: a store of files (a folder, or anything fsspec opens), and its
contents as tables, JSON and a page. Nothing here runs while a machine is measured. Needs the extra
``stepdiag[fleet]``; imported by `cli` only, inside its functions.
"""
