"""What the shop's other programs hear of a survey: its state, findings and result, sent to a broker by a process of its own."""
