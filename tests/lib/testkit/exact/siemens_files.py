"""The worked example of the controllers' reference (section 12) as SINUMERIK files: the screw that
is too short everywhere, and a sag."""

EEC_GOLDEN = """\
%_N_AX_EEC_INI
CHANDATA(1)
$AA_ENC_COMP[0,0,AX1]=0.0040
$AA_ENC_COMP[0,1,AX1]=0.0010
$AA_ENC_COMP[0,2,AX1]=0.0000
$AA_ENC_COMP[0,3,AX1]=-0.0020
$AA_ENC_COMP[0,4,AX1]=-0.0050
$AA_ENC_COMP_STEP[0,AX1]=100.0
$AA_ENC_COMP_MIN[0,AX1]=-200.0
$AA_ENC_COMP_MAX[0,AX1]=200.0
$AA_ENC_COMP_IS_MODULO[0,AX1]=0
M17
"""
CEC_GOLDEN = """\
%_N_NC_CEC_INI
CHANDATA(1)
$AN_CEC[0,0]=0.0000
$AN_CEC[0,1]=0.0025
$AN_CEC[0,2]=0.0040
$AN_CEC[0,3]=0.0040
$AN_CEC[0,4]=0.0040
$AN_CEC_INPUT_AXIS[0]=(AX1)
$AN_CEC_OUTPUT_AXIS[0]=(AX2)
$AN_CEC_STEP[0]=100.0
$AN_CEC_MIN[0]=0.0
$AN_CEC_MAX[0]=400.0
$AN_CEC_DIRECTION[0]=0
$AN_CEC_MULT_BY_TABLE[0]=0
$AN_CEC_IS_MODULO[0]=0
M17
"""
HALL_AXES = """\
[axes.X]
name = "AX1"
step_mm = 50.0
reference_mm = 0.0
[axes.Y]
name = "AX2"
step_mm = 50.0
reference_mm = 0.0
[axes.Z]
name = "AX3"
step_mm = 50.0
reference_mm = 0.0
[siemens]
old_enabled = true
old_weight = 1.0
measuring_system = 1
"""
"""The axes of the hall's machine in a profile."""
HALL_PROFILE = (
    """\
[machine]
name = "virtual"
controller = "siemens"
measured_with = "off"
[limits]
slope_um_mm = 2.0
value_um = 500.0
warn_value_um = 500.0
"""
    + HALL_AXES
)
"""The hall's machine as it was measured without compensation, its limits wide enough for what a
drawn machine needs."""
HALL_EXPORT = '[[export]]\ncontroller = "siemens"\nprofile = "siemens.toml"\n'
"""What the hall's survey exports, by the profile beside it."""
