"""From a result to controller files, and back.

In: a result and a machine's profile. Out: files, their restore files, and their effect on the
machine. Rooms, from the lowest: files, tables, programs and one room a maker, profiles, safety,
export. Imported by `daq` and `stepdiag`.
"""
