"""The exact rigid-body machine, its air and its optics.

Every other package of `virtual` may import this package.
"""
