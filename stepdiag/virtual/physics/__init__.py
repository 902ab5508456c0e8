"""The exact rigid-body machine, its air and its optics.

In: error functions. Out: the place of the tool and the reading of a laser. Every other package of
`virtual` may import this package.
"""
