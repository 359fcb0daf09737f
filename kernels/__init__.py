"""Device code: Warp functions and kernels. No launches, allocations, files or device choices here."""
