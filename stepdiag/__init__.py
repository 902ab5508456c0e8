"""What people touch: commands, the machinist's page, the report, the virtual machine, the demo."""
