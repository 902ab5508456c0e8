"""Compensation files for a control: written from a result, and read from existing files.

The packages import each other in this order, from the lowest: files, tables, programs and one
package per maker, profiles, safety, export.
"""
