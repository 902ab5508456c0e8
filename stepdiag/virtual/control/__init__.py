"""Virtual controls: each loads compensation files and applies them by the law of its real control.

`bench` imports this package.
"""
