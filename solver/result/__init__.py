"""The result: what a survey says, as a value and as JSON.

In: numbers with uncertainties. Out: the same bytes on every machine, and the error field at any position. Imported by model and every
room above, and by the exporters.
"""
