"""The common base of all floors: messages, findings, errors, settings, readings and the result.

Every floor imports this package; it imports only the texts.
"""
