"""The mathematics: numpy arrays in, numpy arrays out; no files, no clocks, no logging."""
