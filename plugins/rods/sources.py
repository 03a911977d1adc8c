"""Where these systems come from."""

BETSCH = "Betsch (2005), CMAME 194; Betsch and Steinmann (2002), IJNME 53"
DIRECTORS = "Romero and Armero (2002), Int. J. Numer. Meth. Eng. 54; Betsch and Steinmann (2002), ibid. 54"
