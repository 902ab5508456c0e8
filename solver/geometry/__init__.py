"""The volume, its diagonals, the machine's chain and the setups.

In: sizes, signs, names. Out: positions, directions, rigid-body displacements. Imported by every room above.
"""
