"""Numbers of stops as a person reads them."""

from collections.abc import Sequence


def ranges(numbers: Sequence[int]) -> str:
    """Return whole numbers as ranges: ``5-12, 14``."""
    parts: list[list[int]] = []
    for number in numbers:
        if parts and number == parts[-1][-1] + 1:
            parts[-1].append(number)
        else:
            parts.append([number])
    return ", ".join(
        str(part[0]) if len(part) == 1 else f"{part[0]}–{part[-1]}" for part in parts
    )
