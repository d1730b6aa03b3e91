"""The search of an actuator's causes: what each has to gain, which are kept, who rivals whom."""
