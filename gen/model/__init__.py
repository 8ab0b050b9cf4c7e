"""The arm as equations: drives, chain, effects at their ports, control laws, and the functions made of them."""
