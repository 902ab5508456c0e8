"""SINUMERIK: EEC and CEC tables, as INI files and as loading programs."""
