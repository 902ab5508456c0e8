"""The adjustment of a survey: the fit, its noise and outliers, and the findings from its residuals.

Input: the model. Output: estimates, variances, findings. `planning` and `methods` import this
package.
"""
