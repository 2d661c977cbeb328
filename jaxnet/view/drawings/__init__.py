"""Drawings as data: made once of what statistics computes, for print and for the page."""
