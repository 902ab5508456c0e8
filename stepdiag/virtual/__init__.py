"""The virtual machine: exact physics, a control, a PLC, a laser and a 4-DOF head on real sockets
and serial lines.

The virtual machine tests the other floors, so it shares no code with them: geometry, kinematics,
register encoding and the parsers of compensation files are written here a second time from first
principles. So a wrong sign cannot cancel itself.
"""
