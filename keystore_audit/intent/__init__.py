"""What was meant: rights that a policy, a running graph or launch files say enclaves are to have."""
