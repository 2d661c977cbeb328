"""Views of results: tables as text, figures for print, and the HTML page."""
