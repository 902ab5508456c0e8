"""The export of a result: with a machine's profile it gives a folder of files and a report.

Input: result, profile, folder. Output: files, hashes and report, or a refusal. `daq.service` and
`stepdiag` import this package.
"""
