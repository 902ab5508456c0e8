"""The interfaces for people: commands, the machinist's page, the report, the virtual machine, the
demo.

In: the user's input, clicks and files. Out: words, pictures, exit codes. Imported by no room;
programs use `stepdiag.api`.
"""
