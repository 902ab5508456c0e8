"""One export: from a result and a profile to a folder of files with its report.

In: result, profile, folder. Out: files, hashes, report, or a refusal. Imported by `daq.service` and
`stepdiag`.
"""
