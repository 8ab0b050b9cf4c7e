"""Self-contained HTML pages: numbers in, one file out that opens offline.

``page`` writes the file, ``figure`` draws the charts and tables, ``animation`` shows the arm moving.
"""
