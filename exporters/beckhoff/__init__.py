"""Beckhoff and ISG: volumetric CSV files and parameter lists."""
