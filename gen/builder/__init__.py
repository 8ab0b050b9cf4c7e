"""From a robot file to a folder of C and a library: files, compiler, cache, checks and tables of documents."""
