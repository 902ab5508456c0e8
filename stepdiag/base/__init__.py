"""What all floors share: messages, findings, causes of refusals, the volume and its setups, files and settings as such.

In: names, sizes, bytes, text. Out: values and refusals. Imported by every floor; imports the texts alone.
"""
