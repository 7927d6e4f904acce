"""The mechanism as arrays of nodes, and exact kinematics of joints and rigid links."""
