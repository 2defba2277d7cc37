"""Results for other programs: files, pictures, objects of other libraries."""
