"""How modlens is built for other machines: wheels, their checks, the packages for gateways."""
