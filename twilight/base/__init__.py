"""What every room may use: errors, units and signs, progress, threads, whole files, digests of code."""
