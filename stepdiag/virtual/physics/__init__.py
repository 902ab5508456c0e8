"""The exact rigid-body machine, its air and its optics.

In: error functions. Out: where the tool is and what a laser sees. Imported by every room above;
serves nothing.
"""
