"""What all floors share: causes of refusals, findings, the volume and its setups, files and settings as such.

In: names, sizes, bytes, text. Out: values and refusals. Imported by every floor; imports none.
"""
