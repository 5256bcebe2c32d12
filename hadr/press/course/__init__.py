"""What a teacher needs: student notebooks, solutions, slides and a plan, made from the chapters."""
