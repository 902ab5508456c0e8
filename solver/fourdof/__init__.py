"""The 4-DOF head: detector, common-path compensation, commissioning, statistics.

Input: samples of the detectors. Output: straightness, pitch and yaw with their uncertainty.
`stepdiag.fourdof` and `stepdiag.head` import this package.
"""
