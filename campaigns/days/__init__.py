"""Days: machines whose friction, offsets and temperature are drawn anew each day, identified on one and judged on another."""
