"""The paper's figures and tables, one group a file."""
