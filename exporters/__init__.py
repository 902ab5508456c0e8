"""Controller files: their generation from a result, and the reading of existing files.

Input: a result and a machine's profile. Output: files for the control, restore files, and the
effect of the files on the machine. The packages of this floor, from the lowest: files, tables,
programs and one package a maker, profiles, safety, export. `daq` and `stepdiag` import this floor.
"""
