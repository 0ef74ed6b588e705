"""What people see: tables, pages, records and figures."""
