"""The paper's tables and figures on its virtual prototype, each with what the paper says of it and what comes out here.

``listed`` names them, ``prototype`` is the machine and how it is driven, ``result`` what a figure holds, ``store`` its
files; one module a group of figures.
"""
