"""What the help of commands calls a value where its type says too little."""

import tyro

CHAPTER = tyro.conf.arg(metavar="CHAPTER")
FILE = tyro.conf.arg(metavar="FILE")
FOLDER = tyro.conf.arg(metavar="FOLDER")
ID = tyro.conf.arg(metavar="ID")
"""An object's number, such as 0004."""
NAME = tyro.conf.arg(metavar="NAME")
