"""The PLC: the register block and its Modbus server (TCP or RTU).

`bench` imports this package.
"""
