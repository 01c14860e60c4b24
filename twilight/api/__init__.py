"""What `import twilight` offers."""
