"""The commands of hdagen, one file each: it parses, calls and prints."""
