"""How a region is laid out, painted, meshed and lit: the parts that `mini.build` puts together."""
