"""One module a group of commands; each offers ``register(app)``. Heavy imports stay inside the functions."""

MODULES = (
    "demo",
    "survey",
    "check",
    "run",
    "status",
    "solve",
    "logs",
    "report",
    "control",
    "sign_test",
    "program",
    "plan",
    "fourdof",
<<<<<<< HEAD
    "service",
=======
>>>>>>> 1501c5a (One life of a finding: a doubt keeps the survey open until it is driven again or accepted)
)
"""The groups, in the order in which the help shows them."""
