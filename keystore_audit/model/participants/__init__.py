"""Who takes part: what is read of an enclave, whether it starts, and who else passes for one."""
