"""The virtual machine: exact physics, a control, a PLC, a laser and a 4-DOF head on real sockets
and serial lines.

The virtual machine tests the other floors and shares no code with them. Geometry, kinematics,
register encoding and the parsers of compensation files are written here a second time, so a wrong
sign cannot cancel itself.
"""
