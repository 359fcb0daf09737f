"""Pictures of results; matplotlib is imported only here (extra `charts`)."""
