"""Ordinary machines and heads, and the shops that measure them, by the physics of the bench."""
