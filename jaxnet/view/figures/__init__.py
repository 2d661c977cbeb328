"""Figures for print, as PNG and PDF."""
