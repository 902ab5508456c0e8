"""The figures of the report, each with its numbers: SVG, HTML and CSV, the same bytes for the same
input.

The report and the commands that write single sheets import this package.
"""
