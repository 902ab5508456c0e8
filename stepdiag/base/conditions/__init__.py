"""Air, expansion, and what is assumed of a machine where nothing measured it.

In: temperatures, pressure, humidity. Out: refractive index, growth and their uncertainties.
Imported by daq and the solver.
"""
