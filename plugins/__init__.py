"""The integrators and scenarios that ship with tcbench, through the same door as everyone's."""
