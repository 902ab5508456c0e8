"""Values of the standards: ISO 230-2 and 230-6, and straightness.

Input: arrays. Output: values with the symbols of the standards. `fourdof`, `methods` and
`stepdiag` import this package.
"""
