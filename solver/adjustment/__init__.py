"""The adjustment of a survey: noise, outliers, the fit, and the verdict of its residuals.

Input: the model. Output: estimates, variances, findings. `planning` and `methods` import this
package.
"""
