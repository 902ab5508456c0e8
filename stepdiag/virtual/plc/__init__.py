"""The PLC: the register block and its Modbus server.

In: the drive. Out: registers on TCP or RTU. `bench` imports this package.
"""
