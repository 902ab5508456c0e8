"""Whether laser and PLC are ready for a survey: their live data, and their faults.

In: a survey file and open links. Out: observations and a diagnosis. `cli.check` imports this
package.
"""
