"""The figures of the report: each a drawing and the numbers behind it.

In: a result, or its points. Out: SVG, HTML and CSV, the same bytes for the same input. Imported by
the report and by the single sheets.
"""
