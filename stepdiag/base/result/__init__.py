"""The result of a survey, as a value and as JSON.

In: numbers with uncertainties. Out: the same bytes on every machine, and the error field at any
position. Imported by the solver, the exporters and what puts them together.
"""
