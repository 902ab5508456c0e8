"""Figures of the standards: ISO 230-2 and 230-6, and straightness.

Input: arrays. Output: figures with the symbols of the standards. All other rooms of the solver may
import this room.
"""
