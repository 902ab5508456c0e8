"""The figures of the report: each consists of a drawing and its numbers.

In: a result, or its points. Out: SVG, HTML and CSV, the same bytes for the same input. The report
and the commands that write single sheets import this package.
"""
