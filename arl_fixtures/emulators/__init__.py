"""The same protocols from the other side, with the behaviour of real devices."""
