"""The table of readings: the door for data.

In: CSV text or rows. Out: validated readings, their unbroken stretches and their travel. Imported by model and planning.
"""
