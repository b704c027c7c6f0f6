"""Each file: our interfaces and one outside package. Only ``registry`` names them, as strings."""
