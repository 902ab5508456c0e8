"""The proof run after loading: a diagonal and a line, from which each table is judged.

Input: the readings of the survey and of the proof run, the active tables. Output: a verdict on each
table, and the decision to keep the tables or restore the control. Only `stepdiag` imports this
package.
"""
