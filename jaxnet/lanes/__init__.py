"""A cell and some samples become lanes: everything is drawn, and engines can take them."""
