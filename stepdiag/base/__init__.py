"""The common base of all floors: messages, findings, refusals, the volume and its setups, files,
settings, readings and the result.

In: names, sizes, bytes, text. Out: values and refusals. Every floor imports this package; this
package imports only the texts.
"""
