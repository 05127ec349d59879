"""How a component becomes an FMU: declaration language, C generation, XML, compilers, archive."""
