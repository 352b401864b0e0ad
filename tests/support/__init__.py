"""What several tests share: clips of known truth, slow twins of the kernels, and stand-ins for programs and hosts."""
