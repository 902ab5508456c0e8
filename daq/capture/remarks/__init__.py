"""What machine, sensors and streams remark of themselves beside the stops, in words for a person.

In: registers, air, streams. Out: findings. Imported by the rest of `capture`, and by those who tell what nobody can check.
"""
