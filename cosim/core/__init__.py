"""What all packages of `cosim` share: errors, exact time, the interface of a component, plain data and packed files."""
