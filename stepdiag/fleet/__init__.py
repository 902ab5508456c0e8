"""An archive of finished surveys of many machines: changes, their times, and old logs solved again.

The archive is a store of files: a folder, or an address that fsspec opens. The package needs the
extra ``stepdiag[fleet]``, never runs during a measurement, and is imported only by functions of
`cli`.
"""
