"""The daemon for a person: journal, page, metrics, the state of a survey on disk, replay.

In: a survey file or its folder. Out: a running service, its words, its replay. Imported by `cli`.
"""
