"""The adjustment of a survey: noise, outliers, the fit, and the verdict of its residuals.

In: the model. Out: estimates, variances, findings. Imported by uncertainty, planning and methods.
"""
