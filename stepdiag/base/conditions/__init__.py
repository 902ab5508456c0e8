"""Air, expansion, and the assumptions about a machine where no measurement exists.

In: temperatures, pressure, humidity. Out: refractive index, growth and their uncertainties. The
floors daq and solver import this package.
"""
