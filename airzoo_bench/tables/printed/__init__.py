"""Numbers as papers print them: exact digits, tables of them, and the counts they can be."""
