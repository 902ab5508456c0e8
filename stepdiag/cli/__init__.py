"""One module a group of commands; each offers ``register(app)``. Heavy imports stay inside the functions."""

MODULES = (
    "demo",
    "survey",
    "setup",
    "check",
    "run",
    "status",
    "accept",
    "correct",
    "begin",
    "solve",
    "runs",
    "logs",
    "report",
    "certificate",
    "control",
    "sign_test",
    "program",
    "plan",
    "fourdof",
    "fleet",
    "publish",
    "service",
)
"""The groups, in the order in which the help shows them."""
