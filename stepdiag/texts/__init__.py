"""What is said to people, in every language.

In: a code. Out: a sentence. Imported by page, report and daemon.
"""
