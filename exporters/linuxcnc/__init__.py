"""LinuxCNC: COMP_FILEs, squareness coefficients of matrixkins, and a kinematics component."""
