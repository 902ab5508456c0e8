"""The 4-DOF head: detector, common-path compensation, commissioning, statistics.

In: samples of the detectors. Out: straightness, pitch and yaw with their uncertainty. Imported by
methods and by `daq.head`.
"""
