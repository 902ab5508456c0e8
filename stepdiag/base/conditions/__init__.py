"""Air, expansion, and the assumptions about a machine where no measurement exists.

In: temperatures, pressure, humidity. Out: refractive index, growth and their uncertainties.
Imported by daq and the solver.
"""
