"""The paper's tables and figures on its virtual prototype: each claim of the paper beside the result here.

``listed`` has the list of all figures, ``prototype`` the machine and its runs, ``result`` the content of a figure,
``store`` its files. Each group of figures has a module of its own.
"""
