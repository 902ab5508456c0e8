"""The export of a result: files for a control and a report, made with the profile of a machine."""
