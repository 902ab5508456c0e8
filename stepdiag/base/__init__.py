"""The common base of all floors: messages, findings, errors, settings, readings and the result.

A floor is a layer of the program (docs/architecture.md). Every floor imports this package; this
package imports only `stepdiag.texts`.
"""
