"""The agents: HEX-o-SKIN cells, their patches, and the process that hosts them."""
