"""The one adjustment of a survey: noise, outliers, the fit, and what its residuals say.

In: the model. Out: estimates, variances, findings. Imported by uncertainty, planning and methods.
"""
